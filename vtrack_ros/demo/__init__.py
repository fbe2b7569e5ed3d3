"""The demonstration: player, node and recorder, each in a process of its own."""
