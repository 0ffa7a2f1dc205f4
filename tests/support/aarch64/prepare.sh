#!/bin/sh
# prepare.sh FOLDER: unpacks a Debian arm64 Python into FOLDER/root, the tests' libraries into FOLDER/site, and
# cross-compiles the kernel into FOLDER/kernel. No chroot, no binfmt: qemu finds its files below FOLDER/root.
set -eu
folder=$(mkdir -p "$1" && cd "$1" && pwd)
cd "$(dirname "$0")/../../.."
python=3.11  # Debian 12's
packages="libc6 libgcc-s1 libstdc++6 zlib1g libexpat1 libbz2-1.0 liblzma5 libffi8 libssl3 libcrypt1 libsqlite3-0
    libuuid1 libncursesw6 libtinfo6 libreadline8 libpython$python-minimal libpython$python-stdlib python$python-minimal libpython$python-dev"

# apt with lists and a dpkg status of its own: this machine's stay as they are.
state=$folder/apt
apt() {
    apt-get -qq -o APT::Architecture=arm64 -o APT::Architectures=arm64 -o Dir::State="$state" \
        -o Dir::State::status="$state/status" -o Dir::Cache="$state/cache" -o APT::Sandbox::User=root "$@"
}
if [ ! -e "$folder/root/usr/bin/python$python" ]; then
    mkdir -p "$state/lists/partial" "$state/cache/archives/partial" "$folder/debs"
    : >"$state/status"
    apt update
    (cd "$folder/debs" && apt download $packages)
    for deb in "$folder"/debs/*.deb; do dpkg-deb -x "$deb" "$folder/root"; done
fi

platforms=$(for minor in $(seq 17 36); do echo "--platform manylinux_2_${minor}_aarch64"; done)
if [ ! -e "$folder/site/ready" ]; then
    "${PYTHON:-python3}" -m pip install --quiet --only-binary=:all: --python-version $python --implementation cp \
        $platforms --platform manylinux2014_aarch64 --target "$folder/site" \
        numpy msgspec mcap cantools packaging pymavlink pyserial python-can "pytest>=8" hypothesis scipy
    touch "$folder/site/ready"
fi

mkdir -p "$folder/kernel"
aarch64-linux-gnu-gcc -shared -fPIC -O3 -ffp-contract=fast -Wno-psabi -Iedge_runtime/policy \
    -isystem "$folder/root/usr/include/python$python" -isystem "$folder/root/usr/include" \
    edge_runtime/policy/_kernel.c -lm -o "$folder/kernel/_kernel.cpython-311-aarch64-linux-gnu.so"

# A checkout of its own: nothing that was built for this machine is in reach.
rm -rf "$folder/checkout"
mkdir "$folder/checkout"
git ls-files -z edge_runtime firmware_bridge tests pyproject.toml | xargs -0 cp --parents -t "$folder/checkout"
cp "$folder"/kernel/*.so "$folder/checkout/edge_runtime/policy"
