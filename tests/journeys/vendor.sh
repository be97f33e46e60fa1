# from docs/other_tools.md
cp "$(python -c 'from harness.files.paths import fmus; print(fmus()["target"])')" target.fmu
fmpy info target.fmu
fmpy validate target.fmu
fmpy simulate target.fmu --stop-time 10 --output-interval 1 --start-values mass 120 \
    --output-file t.csv
# check: eleven rows of the outputs
test "$(wc -l < t.csv)" -eq 12
