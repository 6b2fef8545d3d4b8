# The core, which draws by itself:         docker build -t domino-data .
# The same for NVIDIA GPUs:                docker build --target gpu -t domino-data:gpu .
# With extras:                             docker build --build-arg EXTRAS="--extra ray --extra s3" -t domino-data .
FROM ghcr.io/astral-sh/uv:0.9 AS uv

FROM debian:13-slim AS packages
COPY --from=uv /uv /bin/uv
RUN apt-get update && apt-get install -y --no-install-recommends ca-certificates
WORKDIR /src
ENV UV_LINK_MODE=copy UV_PROJECT_ENVIRONMENT=/opt/domino UV_PYTHON_INSTALL_DIR=/opt/python
ARG EXTRAS=""
COPY pyproject.toml uv.lock ./
RUN uv sync --frozen --no-cache --no-default-groups --no-install-project --python 3.12 ${EXTRAS}
COPY . .
RUN uv sync --frozen --no-cache --no-default-groups --no-editable --python 3.12 ${EXTRAS}

FROM debian:13-slim AS core
RUN apt-get update \
    && apt-get install -y --no-install-recommends libgomp1 libx11-6 \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --create-home --home-dir /data --uid 1000 domino
COPY --from=packages /opt /opt
# the root may be read-only: whatever is written goes to the volume
ENV PATH=/opt/domino/bin:$PATH HOME=/data \
    PYTHONPYCACHEPREFIX=/data/.cache/python NUMBA_CACHE_DIR=/data/.cache/numba
USER domino
WORKDIR /data
VOLUME /data
ENTRYPOINT ["domino-data"]
CMD ["--help"]

FROM core AS gpu
USER root
RUN apt-get update \
    && apt-get install -y --no-install-recommends libegl1 libglvnd0 libvulkan1 libxext6 \
    && rm -rf /var/lib/apt/lists/*
ENV NVIDIA_VISIBLE_DEVICES=all NVIDIA_DRIVER_CAPABILITIES=all
USER domino

# what is built without --target
FROM core
