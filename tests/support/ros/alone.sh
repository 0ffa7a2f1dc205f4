#!/bin/sh
# alone.sh COMMAND...: runs it in a network namespace of its own, where only the loopback is, with multicast for DDS.
set -eu
in_it='ip link set lo up && ip link set lo multicast on && ip route add 224.0.0.0/4 dev lo && exec "$@"'
if [ "$(id -u)" = 0 ]; then exec unshare --net sh -c "$in_it" sh "$@"; fi
exec unshare --map-root-user --net sh -c "$in_it" sh "$@"
