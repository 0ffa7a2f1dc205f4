#!/bin/sh
# Installs the browser in which tests/edge_runtime/tools/report/test_browser.py opens reports.
# Where that cannot be done the tests are skipped, but not in CI.
set -eu
command -v chromium >/dev/null && exit
if ! command -v apt-get >/dev/null || [ "$(id -u)" != 0 ]; then
    echo "the tests of pages in a browser need chromium (Debian: apt-get install chromium): skipping them"
    test -z "${CI:-}"
    exit
fi
apt-get update -qq
DEBIAN_FRONTEND=noninteractive apt-get install -qq --no-install-recommends chromium fonts-dejavu-core >/dev/null
