"""Software in the loop: real robot processes against firmware and a plant that answer on the wire."""
