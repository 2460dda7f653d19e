# extract, check, convert and diff: no git, no OpenCV, no display library.
#   docker build --target extract --tag calibrary . && docker run --rm -v "$PWD:/data" calibrary extract survey
FROM python:3.13-slim AS build
COPY . /source
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels /source

FROM python:3.13-slim AS extract
RUN --mount=from=build,source=/wheels,target=/wheels pip install --no-cache-dir /wheels/*.whl \
    && useradd --create-home keeper
USER keeper
WORKDIR /data
ENTRYPOINT ["calibrary"]

# Everything: the registry needs git, boards need OpenCV (headless, so no libGL), pages need Matplotlib.
FROM extract AS all
USER root
RUN --mount=from=build,source=/wheels,target=/wheels apt-get update \
    && apt-get install --yes --no-install-recommends git openssh-client \
    && rm -rf /var/lib/apt/lists/* \
    && pip install --no-cache-dir "$(echo /wheels/*.whl)[all,opencv]"
USER keeper
