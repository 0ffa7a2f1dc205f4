"""From the team's plane to a base's own frame and its wheels."""
