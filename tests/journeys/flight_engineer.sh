# from docs/how_to/flight_code.md
harness build --c-api adaptive_controller out
make -C out test > tests.txt
# check: the reference vectors have equal bits
grep -q 'adaptive_controller: 101 rows, all bits equal' tests.txt
