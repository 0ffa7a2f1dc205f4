"""The same Navigation policy in teams of other sizes, in less room, and with robots of other masses."""
