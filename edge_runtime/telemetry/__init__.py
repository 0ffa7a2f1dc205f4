"""What a robot tells whoever watches it."""
