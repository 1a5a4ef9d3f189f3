# The two commands of the README, and what maintainers use.
CURLSMOKE = cargo run --release --quiet --bin curlsmoke --

.PHONY: plume test gallery refs bench profile

plume:
	./bootstrap.sh
	cargo build --release --bin curlsmoke
	$(CURLSMOKE) render scenes/plume.yaml

test:
	./bootstrap.sh
	cargo test

# The pictures of docs/gallery/.
gallery:
	./bootstrap.sh
	$(CURLSMOKE) render scenes/plume.yaml --frames 12 --resolution 640x360 --spp 512 --set output.preview=docs/gallery/plume.png
	$(CURLSMOKE) render scenes/ring.yaml --set output.preview=docs/gallery/ring.png
	$(CURLSMOKE) render scenes/cloud.yaml --set output.preview=docs/gallery/cloud.png

# Remakes the references of the image tests: make refs REASON="what changed, and why the pictures should"
refs:
	@test -n "$(REASON)" || { echo 'make refs needs a reason: make refs REASON="what changed, and why the pictures should"' >&2; exit 2; }
	./bootstrap.sh
	CURLSMOKE_REMAKE_REFS="$(REASON)" cargo test --release --test images
	@echo "- $$(date -u +%F): $(REASON)" >> refs/README.md

bench:
	./bootstrap.sh
	cargo bench
