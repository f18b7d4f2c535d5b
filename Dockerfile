# Image of prefect-robomaker: command line, job workers, and the Prefect server that they are tested with.
#
#   docker build -t prefect-robomaker:0.1.0 .
#
# deployments/compose.yaml and deployments/kubernetes/ run it (docs/machines.md).
FROM python:3.12.11-slim-bookworm AS build
RUN pip install --no-cache-dir "uv>=0.8,<1"
WORKDIR /source
COPY pyproject.toml setup.py uv.lock README.md LICENSE ./
COPY prefect_robomaker prefect_robomaker
COPY schemas schemas
COPY tasks tasks
COPY flows flows
COPY deployments deployments
ENV UV_PROJECT_ENVIRONMENT=/opt/robomaker UV_PYTHON_DOWNLOADS=never
RUN uv sync --frozen --no-dev --no-editable --extra postgresql --compile-bytecode

FROM python:3.12.11-slim-bookworm
COPY --from=build /opt/robomaker /opt/robomaker
# Jobs run as this user; what they keep is below /data, which may be a volume or vanish with the container.
RUN useradd --uid 10001 --create-home robomaker && install --directory --owner robomaker /data
ENV PATH=/opt/robomaker/bin:$PATH ROBOMAKER_HOME=/data DO_NOT_TRACK=1 PREFECT_SERVER_ANALYTICS_ENABLED=false
USER 10001
WORKDIR /data
CMD ["robomaker", "--help"]
