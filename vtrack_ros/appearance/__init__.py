"""What a target looks like in pixels."""
