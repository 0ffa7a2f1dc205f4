#!/bin/sh
# Installs what `make aarch64` needs: an emulator of the robot's processor, and a C compiler for it.
# Where that cannot be done the target is skipped, but not in CI.
missing=
for package in qemu-user gcc-aarch64-linux-gnu libc6-dev-arm64-cross; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q "ok installed" || missing="$missing $package"
done
[ -z "$missing" ] && exit 0
if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
    echo "what runs on aarch64 needs:$missing (Debian: apt-get install$missing)" >&2
    test -z "$CI" && echo "skipping it"
    exit
fi
apt-get update -qq && apt-get install -qq --no-install-recommends -y $missing >/dev/null
