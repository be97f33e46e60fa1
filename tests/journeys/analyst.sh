# from docs/tutorial.md
python -c 'import re, sys; print(re.search(r"^```toml\n(.*?)^```", open(sys.argv[1]).read(), re.M | re.S)[1])' "$DOCS/tutorial.md" > mass.toml
harness campaign mass.toml -o mass.zarr --workers 0
harness report mass.zarr -o mass.html
harness run sync_approach --like mass.zarr#3 -o three.nc
# check: eight runs on the page, and the repeated run
grep -q '8 of 8' mass.html
test -s three.nc
