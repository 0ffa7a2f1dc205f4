"""One robot's control: the bridge's protocol, mission, controller, limits, monitor and the deadline grid."""
