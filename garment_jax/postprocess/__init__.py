"""What happens to a frame after the networks; `pipeline.step` has the order."""
