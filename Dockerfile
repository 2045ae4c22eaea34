# Runs the quick study: docker build --tag wearscope . && docker run --rm --volume "$PWD/out:/study/results" wearscope
# Another command, as in a clone: docker run --rm wearscope wearscope demo
FROM python:3.13-slim

# Packages without a wheel are built.
RUN apt-get update \
    && apt-get install --yes --no-install-recommends build-essential make \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /study
COPY . .
RUN make setup PYTHON=python UV=

ENV PATH="/study/.venv/bin:$PATH" OMP_NUM_THREADS=1
CMD ["snakemake", "--cores", "2", "--configfile", "config/quick.yaml"]
