"""A page in the browser to select and watch a target; served by a node of its own."""
