"""From garment, body and motions to a trained and measured model within a given time: `garment-jax learn`."""
