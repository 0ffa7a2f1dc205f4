#!/bin/sh
# install.sh FOLDER: the ROS that tests/firmware_bridge/ros drives: Debian's rospy and rosmaster, two distributions of
# rclpy in environments of their own, and peers that share nothing with them: rosnodejs, Cyclone DDS.
# Where that cannot be done the tests are skipped, but not in CI.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$1"
folder=$(cd "$1" && pwd)
skip() {
    echo "the tests against ROS need $1: skipping them"
    test -z "${CI:-}"
    exit
}
python=${PYTHON:-python3}
packages="python3-rospy python3-rosmaster python3-geometry-msgs python3-nav-msgs python3-std-msgs
    python3-diagnostic-msgs python3-visualization-msgs
    ros-geometry-msgs ros-nav-msgs ros-std-msgs iproute2"
# shellcheck disable=SC2086 # one word each
if ! dpkg-query --show $packages >/dev/null 2>&1; then
    if ! command -v apt-get >/dev/null || [ "$(id -u)" != 0 ]; then
        skip "Debian's $(echo $packages)"
    fi
    apt-get update -qq || true
    DEBIAN_FRONTEND=noninteractive apt-get install -qq --no-install-recommends $packages >/dev/null ||
        skip "Debian's $(echo $packages), which apt-get could not install"
fi
# The wheels are for x86-64 and CPython 3.11; robots bring their own.
"$python" -c 'import platform, sys; sys.exit((platform.machine(), sys.version_info[:2]) != ("x86_64", (3, 11)))' ||
    skip "Python 3.11 on x86-64, for which there are wheels of rclpy"
installing=
for distribution in kilted jazzy cyclone; do
    environment=$folder/$distribution
    wanted=$here/$distribution.txt
    cmp -s "$wanted" "$environment/installed.txt" && continue
    # All at once: most of it is waiting for the index and the disk.
    {
        rm -rf "$environment"
        "$python" -m venv "$environment" &&
            "$environment/bin/pip" install --quiet --require-hashes -r "$wanted" &&
            cp "$wanted" "$environment/installed.txt"
    } &
    installing="$installing $!"
done
for process in $installing; do
    wait "$process" || skip "what pip could not install of $here/*.txt"
done
# Messages for rosnodejs are generated once, from Debian's definitions.
if ! cmp -s "$here/peers/package.json" "$folder/node/installed.json"; then
    command -v npm >/dev/null || skip "npm"
    rm -rf "$folder/node"
    mkdir -p "$folder/node/generated"
    for name in std_msgs geometry_msgs nav_msgs actionlib_msgs; do
        mkdir -p "$folder/node/definitions/$name"
        cp -r "/usr/share/$name/msg" "$folder/node/definitions/$name/"
        echo "<package><name>$name</name></package>" >"$folder/node/definitions/$name/package.xml"
    done
    cp "$here/peers/package.json" "$folder/node/package.json"
    npm install --prefix "$folder/node" --no-package-lock --no-audit --no-fund --loglevel=error ||
        skip "rosnodejs, which npm could not install"
    CMAKE_PREFIX_PATH=$folder/node/generated ROS_PACKAGE_PATH=$folder/node/definitions \
        node "$folder/node/node_modules/rosnodejs/dist/tools/generateMessages.js" -p nav_msgs >/dev/null
    cp "$here/peers/package.json" "$folder/node/installed.json"
fi
