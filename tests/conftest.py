"""Settings of all tests."""

import os
import signal

# One thread for linear algebra, here and in what tests start: pytest-xdist already runs a process
# on each core, and idle threads of these libraries keep a core busy while they wait.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

# If a shell starts the tests in the background, it has set them to ignore Ctrl-C, and all processes
# that they start inherit it.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
