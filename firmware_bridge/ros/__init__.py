"""ROS 1 and ROS 2: profiles, clients, the guard's link; who does not use it needs nothing of ROS."""
