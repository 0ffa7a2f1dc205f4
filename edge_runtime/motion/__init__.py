"""From actions to predicted motion: previews of one robot, and the outlook on its team."""
