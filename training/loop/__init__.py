"""The one training loop, with its batches, checkpoints and curves.

Start with `train`, which trains every network of proxops: it takes a `TrainingTask` (network, loss,
batches, schedule) and continues after a kill behind the last complete epoch. A new network needs a
new task, not a new loop. The batches come from `TensorBatches` or `WindowBatches`.
"""

from proxops.training.loop.checkpoints import write_tensors
from proxops.training.loop.tensor_batches import TensorBatches
from proxops.training.loop.training_history import Trained
from proxops.training.loop.training_loop import Schedule, TrainingTask, seeded, train
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
    "write_tensors",
]
