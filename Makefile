# The two commands of the README, and what maintainers use.
.PHONY: test
test:
	./bootstrap.sh
	cargo test
