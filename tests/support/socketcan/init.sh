#!/bin/sh
# First process of the guest: loads CAN, runs the scenarios, powers off. Arguments: Python, folder of tests, report.
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/tmp
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t devtmpfs dev /dev 2>/dev/null
mkdir -p /dev/pts
mount -t devpts pts /dev/pts
mount -t tmpfs tmp /run
mkdir /run/report /run/tmp
mount -t hostfs -o "$(dirname "$report")" report /run/report
modules=/usr/lib/uml/modules/$(uname -r)/kernel
for module in net/can/can net/can/can-raw drivers/net/can/dev/can-dev drivers/net/can/slcan/slcan; do
    insmod "$modules/$module.ko"
done
cd "$tests"
TMPDIR=/run/tmp "$python" -m socketcan.guest "/run/report/$(basename "$report")"
echo o >/proc/sysrq-trigger  # Powers off, soon: the first process must not end before.
sleep 60
