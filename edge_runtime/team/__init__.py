"""The team around one robot: who belongs to it, how old what they said is, orders and streams."""
