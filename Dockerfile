# docker build -t proxops . && docker run --rm -v "$PWD/out:/work/out" proxops fly
FROM python:3.12-slim
COPY . /tmp/source
RUN pip install --no-cache-dir --constraint /tmp/source/constraints.txt /tmp/source && rm -r /tmp/source
WORKDIR /work
# Compiled for this image, not in each container.
ENV XDG_CACHE_HOME=/cache
RUN proxops fly --out /tmp/flight && rm -r /tmp/flight && chmod -R a+rwX /cache
ENTRYPOINT ["proxops"]
CMD ["--help"]
