"""The fleet file: who is in the team, what it follows, and the network that it speaks over."""
