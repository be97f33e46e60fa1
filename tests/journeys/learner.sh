# from docs/how_to/own_sensor.md
harness new sensor my_gps
harness build my_gps
harness run my_gps --params clear -o gps.nc
harness report gps.nc -o gps.html
harness new plant my_tank
harness build my_tank
harness run my_tank --params clear -o tank.nc
# check: the requirements are met with the sensor
grep -q '4 of 4 requirements met' gps.html
test -s tank.nc
