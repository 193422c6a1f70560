# The two commands in a container: docker build -t locsnn-compile . && docker run --rm -v "$PWD:/work" locsnn-compile MODEL
FROM python:3.12-slim-bookworm

# Compiling and playing need no torch; to train, install '/src[train]'.
ENV PIP_NO_CACHE_DIR=1
COPY pyproject.toml constraints.txt README.md LICENSE /src/
COPY hw_model /src/hw_model
COPY locsnn_compile /src/locsnn_compile
RUN pip install --constraint /src/constraints.txt /src && rm -r /src

# Loops that are compiled at the first run are kept here.
RUN useradd --create-home locsnn
USER locsnn
WORKDIR /work
ENTRYPOINT ["locsnn-compile"]
CMD ["--help"]
