"""edge-doctor: what a run rests on, checked before anybody arms."""
