#!/bin/sh
# scripts.sh VERSION FOLDER: what dpkg runs, into FOLDER.
set -eu
here=$(dirname "$0")
cp "$here/standing" "$2/preinst"
cp "$here/standing" "$2/prerm"
cat "$here/standing" "$here/postinst" | sed "s/VERSION/$1/" >"$2/postinst"
cp "$here/postrm" "$2/postrm"
chmod 755 "$2/preinst" "$2/prerm" "$2/postinst" "$2/postrm"
