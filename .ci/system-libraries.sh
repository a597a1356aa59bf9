#!/bin/sh
# Open3D's import needs these shared libraries. Installs them with apt where it may, otherwise says how.
set -eu

missing=""
for pair in libusb-1.0.so.0:libusb-1.0-0 libGL.so.1:libgl1 libEGL.so.1:libegl1 libX11.so.6:libx11-6 libgomp.so.1:libgomp1; do
    library=${pair%%:*}
    package=${pair##*:}
    PATH="$PATH:/sbin:/usr/sbin" ldconfig -p 2>/dev/null | grep -qF "$library" || missing="$missing $package"
done
[ -n "$missing" ] || exit 0

as_root=""
if [ "$(id -u)" -ne 0 ]; then
    if command -v sudo >/dev/null 2>&1 && sudo -n true 2>/dev/null; then as_root="sudo -n"; else as_root="no"; fi
fi
if [ "$as_root" = "no" ] || ! command -v apt-get >/dev/null 2>&1; then
    echo "make setup: Open3D needs system libraries that are missing; install them, then try again: sudo apt-get install --yes$missing" >&2
    exit 1
fi
echo "make setup: installing$missing" >&2
export DEBIAN_FRONTEND=noninteractive
$as_root apt-get update -qq
# shellcheck disable=SC2086  # the list is words on purpose
$as_root apt-get install --yes -qq --no-install-recommends $missing >/dev/null
