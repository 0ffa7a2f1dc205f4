#!/bin/sh
# Installs what tests/test_socketcan.py boots: user-mode Linux with its CAN modules, and tools for the guest.
# Elsewhere than in CI the test is skipped where this cannot be done.
set -eu
cd "$(dirname "$0")"
missing=
for package in user-mode-linux:linux.uml kmod:insmod iproute2:ip gcc:gcc libc6-dev:; do
    command=${package#*:}
    [ -n "$command" ] && command -v "$command" >/dev/null || \
        dpkg -s "${package%%:*}" >/dev/null 2>&1 || missing="$missing ${package%%:*}"
done
if [ -n "$missing" ]; then
    if ! command -v apt-get >/dev/null || [ "$(id -u)" != 0 ]; then
        echo "the SocketCAN tests need:$missing (Debian: apt-get install$missing): skipping them"
        test -z "${CI:-}"
        exit
    fi
    apt-get update -qq
    DEBIAN_FRONTEND=noninteractive apt-get install -qq --no-install-recommends $missing >/dev/null
fi
mkdir -p build
[ build/xstate.so -nt xstate.c ] || gcc -shared -fPIC -O2 -Wall -Wextra -o build/xstate.so xstate.c -ldl
