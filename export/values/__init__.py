"""What actions are worth under a trained policy, fitted where guidance leads it."""
