"""What steers the flow: an objective set, the guide made of it, projections, and `flow`, the method."""
