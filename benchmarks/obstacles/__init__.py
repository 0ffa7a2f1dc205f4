"""Whether a team arrives past obstacles that no robot knows of."""
