export PYTHONPATH=/tmp/wt/speed/build/links PATH=/work/main/.venv/bin:$PATH OPENBLAS_NUM_THREADS=1
