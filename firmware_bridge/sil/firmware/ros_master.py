"""``python -m firmware_bridge.sil.firmware.ros_master PORT FOLDER...``: ROS 1's own master, for one run."""

import sys

from firmware_bridge.ros.installed import load

if __name__ == "__main__":
    (master,) = load(("rosmaster.main",), sys.argv[2:])
    master.rosmaster_main(["rosmaster", "--core", "-p", sys.argv[1]])
