"""What happens to a frame after the networks; `pipeline` has the order: `shape_step`, then `contact_step`."""
