# from docs/tutorial.md
harness run sync_approach --params clear -o approach.nc
harness list sync_approach
harness show sync_approach.servicer mass
harness plot approach.nc
harness report approach.nc -o approach.html
# check: a page with the replay, all requirements met
grep -q '4 of 4 requirements met' approach.html
