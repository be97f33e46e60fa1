# from docs/own_controller.md
harness new controller my_pd
harness build my_pd
harness run sync_approach --swap controller=my_pd -o my_pd/my_pd.nc
harness plot my_pd/my_pd.nc
harness compare sync_approach --swap controller=my_pd --latency controller=0,1
# check: both variants are in the table
test "$(wc -l < results/sync_approach/comparison.csv)" -ge 3
