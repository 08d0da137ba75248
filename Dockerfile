# Shepherd: `manage.py serve` is the whole of it in one container (docker-compose.embedded.yml), or its web (docker-compose.yml).
FROM python:3.11-slim

WORKDIR /shepherd
ENV PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1 PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 \
    HOST=0.0.0.0 PORT=8000 SHEPHERD_DATA=/data SHEPHERD_LOG=stderr

# The packages change seldom: a layer of their own. With --build-arg PIP_EXTRA_INDEX_URL=... pip finds PyTorch's CPU build.
ARG PIP_EXTRA_INDEX_URL=
ARG REQUIREMENTS=requirements.txt
COPY requirements.txt requirements-s3.txt ./
RUN pip install -r $REQUIREMENTS

COPY manage.py ./
COPY shepherd shepherd
COPY agents_app agents_app
COPY envs_app envs_app
COPY frontend frontend

RUN useradd --uid 10001 --create-home shepherd && install -d -o shepherd -g shepherd /data /data/saves
USER shepherd
VOLUME /data
EXPOSE 8000
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=10s --timeout=5s --start-period=60s \
    CMD ["sh", "-c", "python -c \"import urllib.request as r; r.urlopen('http://127.0.0.1:$PORT/readyz', timeout=4)\""]
CMD ["python", "manage.py", "serve"]
