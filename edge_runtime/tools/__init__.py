"""For operator and workstation: nothing that drives a robot imports from here."""
