#!/bin/sh
# Open3D's import needs these shared libraries. Installs them with apt where it may, otherwise says how.
# With "browser" it installs what the tests of pages drive, and goes on where it may not: those tests are then skipped.
set -eu
PATH="$PATH:/sbin:/usr/sbin"

missing=""
if [ "${1:-}" = browser ]; then
    who="tests of pages"
    for pair in chromium:chromium chromedriver:chromium-driver; do
        command -v "${pair%%:*}" >/dev/null 2>&1 || missing="$missing ${pair##*:}"
    done
else
    who="Open3D"
    for pair in libusb-1.0.so.0:libusb-1.0-0 libGL.so.1:libgl1 libEGL.so.1:libegl1 libX11.so.6:libx11-6 libgomp.so.1:libgomp1; do
        ldconfig -p 2>/dev/null | grep -qF "${pair%%:*}" || missing="$missing ${pair##*:}"
    done
fi
[ -n "$missing" ] || exit 0

as_root=""
if [ "$(id -u)" -ne 0 ]; then
    if command -v sudo >/dev/null 2>&1 && sudo -n true 2>/dev/null; then as_root="sudo -n"; else as_root="no"; fi
fi
if [ "$as_root" = "no" ] || ! command -v apt-get >/dev/null 2>&1; then
    echo "make setup: $who need what is missing; install it, then try again: sudo apt-get install --yes$missing" >&2
    [ "$who" != Open3D ]
    exit
fi
echo "make setup: installing$missing" >&2
export DEBIAN_FRONTEND=noninteractive
$as_root apt-get update -qq
# shellcheck disable=SC2086  # the list is words on purpose
$as_root apt-get install --yes -qq --no-install-recommends $missing >/dev/null
