#!/bin/sh
# First process of the guest: runs edge-sil in a kernel with a clock of its own, powers off.
# Arguments: Python, folder of the checkout, folder with faults.toml and limits.toml, where the report goes too.
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/tmp PYTHONPATH="$root"
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t devtmpfs dev /dev 2>/dev/null
mount -t tmpfs tmp /run
mkdir /run/files /run/tmp
mount -t hostfs -o "$files" files /run/files
ip link set lo up
cd "$root"
before=$(date +%s)
(while sleep 0.5; do jumped=$(($(date +%s) - before)); [ $jumped -gt 1800 ] && echo $jumped >/run/files/jumped; done) &
TMPDIR=/run/tmp "$python" -m firmware_bridge.sil.edge_sil --robots 2 --bridge mavlink --rate 4 --duration 10 \
    --faults /run/files/faults.toml --limits /run/files/limits.toml --json /run/files/report.json
echo o >/proc/sysrq-trigger  # Powers off, soon: the first process must not end before.
sleep 60
