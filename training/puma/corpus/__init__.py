"""What a network learns from: episodes of exports with their annotations, decoded once, and the
samples that are drawn of them."""
