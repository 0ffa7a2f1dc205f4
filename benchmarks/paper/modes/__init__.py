"""Which ways round each other a policy knows."""
