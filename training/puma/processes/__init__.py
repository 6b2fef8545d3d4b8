"""The processes of a training: the network over one or several of them, the memory that this takes,
the operations of a step, and the trackers that are told."""
