"""Compiled code is executed as it is found: it is kept where only its user can write, and made once."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from toppling import Motion, Scene, shake
from toppling.models.compiled import _private_folder, _VerifiedFile
from toppling.models.pedestal import ContactProperties

SHAKE = """
import numpy as np
from toppling import Motion, Scene, shake
time_s = np.arange(0.0, 2.0, 0.005)
pulse = 5.0 * np.sin(2.0 * np.pi * time_s)
motion = Motion(np.column_stack([pulse, 0.3 * pulse, 0.0 * pulse]), 0.005)
result = shake(Scene.block(0.3, 0.3, 1.0), motion, "fast", trajectory=True)
print(result.trajectory.position_m.tobytes().hex()[-4000:])
"""


def test_the_folder_is_its_users_alone_or_there_is_none(tmp_path: Path) -> None:
    folder = _private_folder(tmp_path)
    assert folder is not None
    assert folder.stat().st_mode & 0o777 == 0o700
    assert _private_folder(tmp_path) == folder
    for mode in (0o720, 0o702, 0o777):  # which others can write
        folder.chmod(mode)
        assert _private_folder(tmp_path) is None
    folder.rmdir()
    (tmp_path / "elsewhere").mkdir()
    folder.symlink_to(tmp_path / "elsewhere")
    assert _private_folder(tmp_path) is None
    (tmp_path / "file").touch()
    assert _private_folder(tmp_path / "file") is None


@pytest.mark.parametrize(("mode", "taken"), [(0o755, True), (0o775, False), (0o757, False)])
def test_code_that_an_image_ships_is_taken_where_nobody_else_could_write_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: int, taken: bool
) -> None:
    shipped = _private_folder(tmp_path / "image")
    assert shipped is not None
    (shipped / "room").mkdir()
    (shipped / "room" / "function.nbc").write_bytes(b"code")
    monkeypatch.setenv("TOPPLING_COMPILED", str(tmp_path / "image"))
    unfinished = _private_folder(tmp_path / "first")
    assert unfinished is not None
    assert not list(unfinished.iterdir())
    (shipped / "complete").touch()
    shipped.chmod(mode)
    folder = _private_folder(tmp_path / "second")
    assert folder is not None
    assert {path.relative_to(folder).as_posix() for path in folder.rglob("*")} == (
        {"room", "room/function.nbc", "complete"} if taken else set()
    )
    assert folder.stat().st_mode & 0o777 == 0o700


def _started(cache: Path) -> subprocess.Popen[str]:
    environment = {**os.environ, "TOPPLING_CACHE": str(cache)}
    return subprocess.Popen(
        [sys.executable, "-c", SHAKE],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.slow
def test_two_processes_compile_once_and_without_a_folder_the_bits_are_the_same(tmp_path: Path) -> None:
    started = [_started(tmp_path / "cache") for _ in range(2)]
    together = [process.communicate(timeout=600) for process in started]
    (tmp_path / "file").touch()
    nowhere, _ = _started(tmp_path / "file").communicate(timeout=600)
    bits = [out for out, _ in together]
    assert nowhere
    assert bits == [nowhere] * 2
    assert sum("compiling" in value for _, value in together) == 1


def test_a_flipped_bit_in_compiled_code_is_reported_and_its_function_recompiled(tmp_path, capsys):
    remaining = _VerifiedFile(str(tmp_path), "function", "stamp")
    remaining.save("key", ("machine code", 1.5))
    assert remaining.load("key") == ("machine code", 1.5)
    for path in sorted(tmp_path.iterdir()):
        content = path.read_bytes()
        for at in range(len(content)):
            path.write_bytes(content[:at] + bytes([content[at] ^ 16]) + content[at + 1 :])
            assert remaining.load("key") is None
            assert f"{path} is damaged: compiled anew" in capsys.readouterr().err
        path.write_bytes(content[: len(content) // 2])
        assert remaining.load("key") is None
        remaining.save("key", ("machine code", 1.5))
        assert remaining.load("key") == ("machine code", 1.5)


def test_the_cache_of_every_compiled_function_is_verified():
    from toppling.models import compiled as room

    if room.FOLDER is None:
        pytest.skip("compiled code is kept nowhere on this machine")
    assert type(room.compiled(lambda x: x)._cache._cache_file) is _VerifiedFile


INNER = """
from toppling.models.compiled import compiled, inner

@inner
def root(x):
    print("inner", x)
    if x < 0.0:
        raise ValueError("negative")
    return x ** 0.5

@compiled
def twice(x):
    return 2.0 * root(x)

print(twice(4.0))
try:
    twice(-1.0)
except ValueError as error:
    print(error)
"""


@pytest.mark.thorough
def test_code_is_found_again_wherever_its_source_lies(tmp_path):
    """A checkout and an unpacked wheel of one program compile once together."""
    remaining = []
    for place in ("checkout", "wheel"):
        (tmp_path / place).mkdir()
        program = tmp_path / place / "program.py"
        program.write_text(INNER)
        subprocess.run(
            [sys.executable, program],
            env={**os.environ, "TOPPLING_CACHE": str(tmp_path / "cache")},
            capture_output=True,
            check=True,
        )
        remaining.append({path: path.stat().st_mtime_ns for path in (tmp_path / "cache").rglob("*.nb?")})
    assert len(remaining[0]) == 2  # the code and its index
    assert remaining[0] == remaining[1]


def test_shakes_leave_no_array_of_compiled_code_behind():
    scene, friction = Scene.block(0.3, 0.3, 1.0), ContactProperties(0.4, 0.3, 0.2)
    time_s = np.arange(0.0, 2.0, 0.005)
    pulse = 5.0 * np.sin(2.0 * np.pi * time_s)
    motion = Motion(np.column_stack([pulse, 0.3 * pulse, 0.0 * pulse]), 0.005)
    _nrt_python.memsys_enable_stats()
    before = rtsys.get_allocation_stats()
    for preset in ("fast", "standard"):
        shake(scene.with_contact(friction), motion, preset)
    after = rtsys.get_allocation_stats()
    assert after.mi_alloc > before.mi_alloc  # it slips, which is solved with arrays made on the way
    # What a shake before had left to a cache may be freed too.
    assert after.mi_alloc - before.mi_alloc <= after.mi_free - before.mi_free
