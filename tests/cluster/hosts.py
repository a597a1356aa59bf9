"""Hosts of a cluster on one machine: network namespaces, each with a cable that can be pulled."""

import contextlib
import os
import shutil
import subprocess

HUB_ADDRESS = "10.213.255.1"


def ip(*arguments):
    return subprocess.run(["ip", *arguments], capture_output=True, text=True, check=True)


def can_be_made():
    if os.geteuid() != 0 or shutil.which("ip") is None:
        return False
    name = f"tp{os.getpid()}x"
    with contextlib.suppress(subprocess.CalledProcessError):
        ip("netns", "add", name)
        ip("netns", "delete", name)
        return True
    return False


class Hosts:
    """A hub, where scheduler and client run, and hosts for workers, each on a cable of its own."""

    def __init__(self, count):
        self.hub = f"tp{os.getpid()}h"
        self.workers = [f"tp{os.getpid()}w{n}" for n in range(count)]

    def __enter__(self):
        ip("netns", "add", self.hub)
        ip("-n", self.hub, "link", "set", "lo", "up")
        ip("-n", self.hub, "address", "add", f"{HUB_ADDRESS}/32", "dev", "lo")
        for n, name in enumerate(self.workers):
            ip("netns", "add", name)
            ip("-n", name, "link", "set", "lo", "up")
            ip("link", "add", f"{name}c", "netns", self.hub, "type", "veth", "peer", "eth0", "netns", name)
            for namespace, device, last in ((self.hub, f"{name}c", 1), (name, "eth0", 2)):
                ip("-n", namespace, "address", "add", f"10.213.{n}.{last}/24", "dev", device)
                ip("-n", namespace, "link", "set", device, "up")
            ip("-n", name, "route", "add", HUB_ADDRESS, "via", f"10.213.{n}.1")
        return self

    def __exit__(self, *exception):
        for name in (*self.workers, self.hub):
            with contextlib.suppress(subprocess.CalledProcessError):
                ip("netns", "delete", name)

    def cable(self, worker, *, plugged):
        """Plug a worker's cable in, or pull it at the hub's end: the worker's packets are lost in silence."""
        ip("-n", self.hub, "link", "set", f"{worker}c", "up" if plugged else "down")

    @staticmethod
    def on(host, command):
        return ["ip", "netns", "exec", host, *command]
