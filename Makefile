# The two commands of the README, and what maintainers use.
CURLSMOKE = cargo run --release --quiet --bin curlsmoke --

.PHONY: plume test test-interop test-farm test-page page-picture test-flip gallery flow-pictures paper-tables verification refs alarm-rate bench bench-instructions roofline scaling peers costs

# Fetches what is missing while it builds, whenever a processor has nothing else to do.
plume:
	nice -n 19 ./bootstrap.sh & fetching=$$!; cargo build --release --bin curlsmoke && wait $$fetching
	$(CURLSMOKE) render scenes/plume.yaml --resume

test:
	./bootstrap.sh
	cargo test

# Jobs of `curlsmoke farm`, run by openjd-cli and by Slurm; says which of them is not there.
test-farm:
	./bootstrap.sh
	cargo build --release --bin curlsmoke
	tests/farm/run.sh

# Our .vdb files in OpenVDB's own tools, and in Blender where BLENDER_PYTHON is a Python that can import bpy; says what is not there.
test-interop:
	tests/interop/vdb.sh

# The page of `curlsmoke watch` in a real browser.
test-page page-picture:
	./bootstrap.sh
	@command -v chromedriver >/dev/null || { echo "make: installing chromium and chromium-driver" >&2; \
		apt-get install -y --no-install-recommends chromium chromium-driver >&2; } || \
		{ echo "make: chromedriver is missing and could not be installed; install Chromium and its driver (Debian: chromium chromium-driver)" >&2; exit 1; }
	cargo test --test page -- --ignored --test-threads 1 $(PAGE_TESTS)

test-page: PAGE_TESTS = --skip picture_of_the_page
# docs/watch.png.
page-picture: PAGE_TESTS = picture_of_the_page

# The pictures of docs/gallery/.
gallery:
	./bootstrap.sh
	$(CURLSMOKE) render scenes/plume.yaml --frames 12 --resolution 640x360 --spp 320 -o out/gallery/plume.####.exr --resume
	$(CURLSMOKE) render scenes/ring.yaml --resume
	$(CURLSMOKE) render scenes/cloud.yaml --resume
	mkdir -p docs/gallery
	cp out/gallery/plume.0012.png docs/gallery/plume.png
	cp out/ring.0001.png docs/gallery/ring.png
	cp out/cloud.0001.png docs/gallery/cloud.png
	$(CURLSMOKE) render scenes/torus-marble.yaml --frames 48 --resume
	cp out/torus-marble.0048.png docs/gallery/torus-marble.png
	for scene in lava lava-planet waterfall; do \
		$(CURLSMOKE) render scenes/$$scene.yaml --frames 24 --resolution 640x360 --spp 320 --resume || exit 1; \
		cp out/$$scene.0024.png docs/gallery/$$scene.png; \
	done
	$(CURLSMOKE) render scenes/ember.yaml --frames 36 --resume
	$(CURLSMOKE) render scenes/metals.yaml --frames 36 --resume
	$(CURLSMOKE) render scenes/lamps.yaml --resume
	cp out/ember.0036.png docs/gallery/ember.png
	cp out/metals.0036.png docs/gallery/metals.png
	cp out/lamps.png docs/gallery/lamps.png
	for scene in filaments confined; do \
		$(CURLSMOKE) render scenes/$$scene.yaml --frames 48 --resolution 640x360 --spp 256 --resume || exit 1; \
		cp out/$$scene.0048.png docs/gallery/$$scene.png; \
	done
	$(CURLSMOKE) render scenes/orbit.yaml --frames 44 --spp 320 --resume
	cp out/orbit.0044.png docs/gallery/orbit.png
	$(CURLSMOKE) render scenes/skein.yaml --resume
	cp out/skein.0001.png docs/gallery/skein.png

# The pictures of docs/flow.md.
flow-pictures:
	./bootstrap.sh
	mkdir -p docs/flow
	for scene in scenes/flow/*.yaml; do \
		$(CURLSMOKE) flow slice $$scene -o out/flow/$$(basename $$scene .yaml).png || exit 1; \
	done
	cp out/flow/*.png docs/flow/

# docs/paper-tables.md and its pictures: minutes of all processors.
paper-tables:
	cargo run --release --quiet --example paper_tables

# docs/verification.md: light transport against known answers; fails where one is off. Minutes of all processors.
verification:
	./bootstrap.sh
	cargo run --release --quiet --example verification

# Remakes the references of the image tests: make refs REASON="what changed, and why the pictures should"
refs:
	@test -n "$(REASON)" || { echo 'make refs needs a reason: make refs REASON="what changed, and why the pictures should"' >&2; exit 2; }
	./bootstrap.sh
	$(CURLSMOKE) regress refs/suite.yaml --update --reason "$(REASON)"

# How often the image tests err: false alarms, and changes of a per cent that are found. Writes docs/regression.md; minutes of all processors.
alarm-rate:
	./bootstrap.sh
	cargo run --release --quiet --example alarm_rate

# FLIP against its authors' package, in a Python environment of its own.
test-flip:
	cargo build --release --bin curlsmoke
	python3 -m venv target/flip
	target/flip/bin/pip install --quiet flip-evaluator==1.7 OpenEXR numpy
	target/flip/bin/python tests/interop/flip.py target/release/curlsmoke

# Kernels beside what was recorded, in cycles of a chain that runs beside them; fails where one is slower. RECORD=1 keeps the
# figures in benches/recorded.json, or in docs/performance.md.
bench bench-instructions roofline scaling:
	./bootstrap.sh
	cargo bench --bench kernels -- $(BENCH_TASK) $(if $(RECORD),--record)

bench: BENCH_TASK = compare
# Instructions by callgrind, which repeat.
bench-instructions: BENCH_TASK = instructions
# What bounds the tracing of light on this machine.
roofline: BENCH_TASK = roofline
# Two threads beside one.
scaling: BENCH_TASK = scaling

# Light beside other renderers, with the table and the plot of docs/performance.md: half an hour of all processors, kept idle else.
peers:
	./bootstrap.sh
	cargo build --release --bin curlsmoke
	python3 benches/peers.py --record

# What a frame costs against particles, voxels, pixels, paths, optical depth and threads, with the section and the plot of
# docs/performance.md: a quarter of an hour of all processors, kept idle else.
costs:
	./bootstrap.sh
	cargo build --release --bin curlsmoke
	python3 benches/costs.py --record
