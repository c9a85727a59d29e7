"""The one training loop, its batches, checkpoints and curves.

Start with `train`. Every network of proxops is trained by it; a run that was killed goes on behind
its last whole epoch.
"""

from proxops.training.loop.random_weights import seeded
from proxops.training.loop.tensor_batches import TensorBatches
from proxops.training.loop.training_history import Trained
from proxops.training.loop.training_loop import Schedule, TrainingTask, train
from proxops.training.loop.windows import Batch, WindowBatches, WindowDataset, frame_batches

__all__ = [
    "Batch",
    "Schedule",
    "TensorBatches",
    "Trained",
    "TrainingTask",
    "WindowBatches",
    "WindowDataset",
    "frame_batches",
    "seeded",
    "train",
]
