"""A page is opened in a browser without its secret in the browser's command line."""

import json
import os
import signal
import subprocess
import sys

from waiting import wait_until

PROGRAM = """
from toppling.orchestrator.loopback import Answers, Loopback
from toppling.orchestrator.verbs.shared_options import served
server = Loopback(Answers)
print(server.secret, flush=True)
served(server, "page", True, "ended")
"""
BROWSER = """#!{python}
import json, os, pathlib, stat, sys, urllib.request
page = pathlib.Path(urllib.request.url2pathname(sys.argv[-1].removeprefix("file://")))
seen = {{"argv": sys.argv, "page": str(page), "text": page.read_text()}}
seen["modes"] = [stat.S_IMODE(path.stat().st_mode) for path in (page, page.parent)]
told = pathlib.Path(__file__).with_name("seen.json")
told.with_suffix(".tmp").write_text(json.dumps(seen))
told.with_suffix(".tmp").replace(told)
"""


def test_no_argument_of_the_browser_holds_the_secret_and_only_this_account_reads_the_page(tmp_path):
    browser, seen = tmp_path / "browser", tmp_path / "seen.json"
    browser.write_text(BROWSER.format(python=sys.executable))
    browser.chmod(0o755)
    began = subprocess.Popen(
        [sys.executable, "-c", PROGRAM], env=os.environ | {"BROWSER": str(browser)},
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    secret = began.stdout.readline().strip()
    wait_until(seen.exists)
    found = json.loads(seen.read_text())
    assert len(secret) > 16
    assert secret not in " ".join(found["argv"])
    assert secret in found["text"]
    assert found["modes"] == [0o600, 0o700]
    began.send_signal(signal.SIGINT)
    began.communicate(timeout=60.0)
    assert not os.path.exists(found["page"])  # noqa: PTH110
