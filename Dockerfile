# SPDX-License-Identifier: Apache-2.0
# The daemon in a container:
#   docker build -t kdray . && docker run -p 8080:8080 -v kdray:/var/lib/kdray kdray
# --build-arg BASE=debian:trixie-slim builds on Debian 13 instead of 12.
# Every option of kdrayd is also an environment variable: KDRAY_MEMORY_LIMIT=2GiB, KDRAY_TOKEN_FILE=/run/secrets/tokens, ...

ARG BASE
FROM ${BASE:-debian:bookworm-slim} AS build
WORKDIR /src
# Before the sources, so this layer is rebuilt only when the list changes.
COPY server/dependencies.sh server/
RUN server/dependencies.sh build && rm -rf /var/lib/apt/lists/*
COPY . .
RUN cmake/build.sh release kdrayd kdray && strip build/release/bin/kdrayd build/release/bin/kdray

FROM ${BASE:-debian:bookworm-slim}
COPY server/dependencies.sh /tmp/
RUN /tmp/dependencies.sh run && apt-get clean && rm -rf /var/lib/apt/lists/* /tmp/dependencies.sh
RUN useradd --system --uid 8080 --user-group --no-create-home --shell /usr/sbin/nologin kdray \
    && install -d -o kdray -g kdray -m 700 /var/lib/kdray
LABEL org.opencontainers.image.title="kdray" \
    org.opencontainers.image.description="Ray queries and renders over triangle meshes, by HTTP" \
    org.opencontainers.image.version="0.1.0" \
    org.opencontainers.image.licenses="Apache-2.0"
COPY --from=build /src/build/release/bin/kdrayd /src/build/release/bin/kdray /usr/local/bin/
# Detects a missing library here, not at the first start.
RUN kdrayd --version && kdray --version
USER kdray
# `docker stop` waits 10 s: requests that are not finished by then are cancelled first.
ENV KDRAY_HOST=0.0.0.0 KDRAY_PORT=8080 KDRAY_DATA_DIR=/var/lib/kdray KDRAY_DRAIN_TIMEOUT_MS=7000
VOLUME /var/lib/kdray
EXPOSE 8080
# The shell opens the connection, so the image needs no HTTP client.
HEALTHCHECK --interval=10s --timeout=3s --start-period=10s CMD ["bash", "-c", \
    "exec 3<>/dev/tcp/127.0.0.1/$KDRAY_PORT && printf 'GET /healthz HTTP/1.1\\r\\nHost: localhost\\r\\nConnection: close\\r\\n\\r\\n' >&3 && read -r -u 3 -t 2 _ status _ && [[ $status == 200 ]]"]
ENTRYPOINT ["kdrayd"]
