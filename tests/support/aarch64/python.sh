#!/bin/sh
# python.sh FOLDER ARGUMENTS: the Python that prepare.sh put into FOLDER, on an emulated Cortex-A78AE.
folder=$(cd "$1" && pwd)
shift
cd "$folder/checkout"
unset PYTHONDONTWRITEBYTECODE OPENBLAS_CORETYPE OPENBLAS_L2_SIZE
export PYTHONPATH="$folder/site:." QEMU_CPU=cortex-a76,midr=0x411fd421 OMP_NUM_THREADS=1
exec qemu-aarch64 -L "$folder/root" "$folder/root/usr/bin/python3.11" "$@"
