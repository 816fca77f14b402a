"""How a garment swings around the body: a recurrent network on a ring of columns that share weights."""
