"""Learning from flights: data, the training loop, the recipes.

Import from its rooms: `data` needs no PyTorch, the others do.
"""
