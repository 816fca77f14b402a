"""What a user brings, body, motion, garment and simulated clips, becomes scenes and sequence files."""
