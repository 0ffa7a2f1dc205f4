"""What steering along the flow is for: scenes of more and harder objectives, and ways to follow them."""
