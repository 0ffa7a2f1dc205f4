"""What export writes: a bundle whose forms agree."""
