"""PUMA: a policy for moving objects, trained on the exports and annotations of domino-data.

Inputs are flow maps of the recent past, the current images, an instruction, N world queries and K
action queries; outputs are a chunk of K joint targets and, in training, what the target will look
like or where it will be at N later moments.

`config` says what is trained and how, `train` trains it, `policy` acts, and `cli` has the commands.
"""
