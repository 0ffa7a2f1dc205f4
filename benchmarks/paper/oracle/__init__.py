"""What the tasks allow: how policies fail, and whether a plan satisfies what no policy did."""
