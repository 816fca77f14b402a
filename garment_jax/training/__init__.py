"""The training loop, its checkpoints, its log and its optimisers; no maths of the method."""
