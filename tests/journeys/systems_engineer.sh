# from docs/own_mission.md
harness new mission mine
harness run mine -o mine.nc
harness report mine.nc --mission mine -o mine.html
# check: the page has the claim of the new mission
grep -q 'the run reaches its end' mine.html
