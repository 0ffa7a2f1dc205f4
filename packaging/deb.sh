#!/bin/sh
# deb.sh FOLDER: Debian packages for amd64 and arm64 of the wheels in FOLDER, into FOLDER. Each carries the wheels of
# all that it needs, for every Python there is a wheel for: a robot needs no network to install it.
set -eu
cd "$(dirname "$0")/.."
out=$(cd "$1" && pwd)
work=$PWD/build/release
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
export SOURCE_DATE_EPOCH PIP_DISABLE_PIP_VERSION_CHECK=1
umask 022
version=$(ls "$out"/cfpg_edge-*.tar.gz | sed 's/.*cfpg_edge-\(.*\)\.tar\.gz/\1/')
maintainer=$(tar xzOf "$out/cfpg_edge-$version.tar.gz" "cfpg_edge-$version/PKG-INFO" | sed -n 's/^Maintainer-email: //p')
pythons=$(ls -d "$work"/env-3.*/bin/python | sed 's|.*/env-3\.\([0-9]*\)/.*|\1|' | sort -n)
first=$(echo "$pythons" | head -1)
last=$(echo "$pythons" | tail -1)
platforms=$(for minor in $(seq 17 28); do echo "--platform manylinux_2_${minor}_PROCESSOR"; done)

wheelhouse() {  # wheelhouse PROCESSOR FOLDER: each Python judges for itself what it needs
    for python in "$work"/env-3.*/bin/python; do
        tag=$("$python" -c 'import sys; print("cp%d%d" % sys.version_info[:2])')
        "$work/tools/bin/pip" --python "$python" download --quiet --only-binary=:all: --dest "$2" \
            $(echo "$platforms" | sed "s/PROCESSOR/$1/") --platform "manylinux2014_$1" "$out"/cfpg_edge-*-"$tag"-*"_$1.whl"
    done
}

package() {  # package ARCHITECTURE PROCESSOR
    root=$work/deb-$1
    rm -rf "$root"
    mkdir -p "$root/DEBIAN" "$root/usr/lib/cfpg-edge" "$root/usr/lib/systemd/system" "$root/etc/cfpg-edge" \
        "$root/usr/share/doc/cfpg-edge"
    wheelhouse "$2" "$root/usr/lib/cfpg-edge/wheels"
    cp edge_runtime/systemd/edge-run@.service "$root/usr/lib/systemd/system"
    cp packaging/debian/environment "$root/etc/cfpg-edge"
    cp packaging/debian/copyright CHANGELOG.md "$out/licences.md" "$out/sbom.cdx.json" "$root/usr/share/doc/cfpg-edge"
    printf 'cfpg-edge (%s) stable; urgency=medium\n\n  * CHANGELOG.md, beside this file, says what changed.\n\n -- %s  %s\n' \
        "$version" "$maintainer" "$(date -R -u -d "@$SOURCE_DATE_EPOCH")" |
        gzip -9n >"$root/usr/share/doc/cfpg-edge/changelog.gz"
    sed "s/VERSION/$version/; s/ARCHITECTURE/$1/; s/MAINTAINER/$maintainer/; s/FIRST/$first/; s/AFTER/$((last + 1))/" \
        packaging/debian/control >"$root/DEBIAN/control"
    echo /etc/cfpg-edge/environment >"$root/DEBIAN/conffiles"
    sh packaging/debian/scripts.sh "$version" "$root/DEBIAN"
    dpkg-deb --root-owner-group -Zgzip --build "$root" "$out" >/dev/null
    dpkg-deb --root-owner-group -Zgzip --build "$root" "$work/again.deb" >/dev/null
    cmp "$work/again.deb" "$out/cfpg-edge_${version}_$1.deb"
}

drive() {  # drive PYTHON: what postinst does on a robot, without a network, and a second of a run
    env=$work/deb-env
    rm -rf "$env"
    "$1" -m venv "$env"
    "$env/bin/pip" install --isolated --quiet --no-index --find-links "$work/deb-amd64/usr/lib/cfpg-edge/wheels" \
        "cfpg-edge==$version"
    (cd "$work" && "$env/bin/edge-run" --robot-id 0 --duration 1 --no-log --backend compiled)
}

package amd64 x86_64
package arm64 aarch64
for python in "$work"/env-3.*/bin/python; do drive "$python"; done
