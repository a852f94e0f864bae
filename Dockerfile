# Debian 13 with the packages of the launcher's own list, and xper_fx in /opt/xper_fx.
#
#     docker build -t xper_fx .
#     docker run --rm -it -v "$PWD:/work" xper_fx fenicsx python3 demos/masonry_arch.py
#
# With Sphinx as well: docker build --build-arg XPER_FX_DOCS=1 -t xper_fx .
FROM debian:13-slim

# As root of Debian 13 the launcher installs what it wants with apt, natively. It comes before the
# rest, so that this layer is built again only when the launcher changes.
ARG XPER_FX_DOCS=
COPY fenicsx /opt/xper_fx/fenicsx
RUN XPER_FX_DOCS=$XPER_FX_DOCS /opt/xper_fx/fenicsx python3 -c "import dolfinx" \
    && apt-get clean \
    && rm -rf /var/lib/apt/lists/* ~/.cache

COPY . /opt/xper_fx
RUN useradd --create-home --uid 1000 xper_fx \
    && mkdir /work \
    && chown xper_fx:xper_fx /work
USER xper_fx
WORKDIR /work
ENV PATH=/opt/xper_fx:$PATH \
    PYTHONPATH=/opt/xper_fx \
    OPENBLAS_NUM_THREADS=1 \
    OMPI_MCA_btl=self,sm
CMD ["bash"]
