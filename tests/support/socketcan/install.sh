#!/bin/sh
# Installs what tests/firmware_bridge/can/test_socketcan.py boots: user-mode Linux with its CAN modules, and tools for the guest.
# Where that cannot be done the tests are skipped, but not in CI.
set -eu
cd "$(dirname "$0")"
missing=
need() {
    command -v "$1" >/dev/null || missing="$missing $2"
}
need linux.uml user-mode-linux
need insmod kmod
need ip iproute2
need gcc "gcc libc6-dev"
if [ -n "$missing" ]; then
    if ! command -v apt-get >/dev/null || [ "$(id -u)" != 0 ]; then
        echo "the tests on a real CAN bus need:$missing (Debian: apt-get install$missing): skipping them"
        test -z "${CI:-}"
        exit
    fi
    apt-get update -qq
    # shellcheck disable=SC2086 # one word each
    DEBIAN_FRONTEND=noninteractive apt-get install -qq --no-install-recommends $missing >/dev/null
fi
mkdir -p build
[ build/xstate.so -nt xstate.c ] || gcc -shared -fPIC -O2 -Wall -Wextra -o build/xstate.so xstate.c -ldl
