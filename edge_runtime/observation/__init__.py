"""From a robot's view of its team to the policy's input."""
