#!/bin/bash
# The cascade of the parametric pendulum with AUTO-07p: bench/auto/cascade.sh START
#
# START   file with an orbit at omega = 13 rad/s: t, phi + omega t, phi_dot, sin(omega t), cos(omega t) per line
#
# Prints per branch: period, points, shortest processor time of seven runs [s], omega of its first doubling. The Debian
# package auto-07p holds AUTO's objects, which each problem is linked with by gfortran.
library=/usr/lib/auto-07p/lib
if [ ! -e $library/main.o ] || ! command -v gfortran > /dev/null; then
    echo "AUTO-07p is not installed (Debian: apt-get install auto-07p): no comparison"
    exit 3
fi
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp "$1" "$work/cascade.dat"
cd "$work" || exit 1
gfortran -O2 -fopenmp -o cascade "$here/parametric_pendulum.f90" $library/*.o || exit 1

# Four collocation points; 50 intervals per period of the orbit that the cascade begins with, AUTO's own tolerances as
# tight as it takes them.
constants() {  # label to start at, its switch, step, intervals
    if [ "$1" = 0 ]; then echo "dat='cascade'"; fi
    cat << END
NMX=4000, SP=['PD1']
NDIM=4, IPS=2, IRS=$1, ILP=1, ICP=[1, 11], NTST=$4, NCOL=4, IAD=3, ISP=2, ISW=$2, NBC=0, NINT=0
RL0=9.0, RL1=13.5, A0=-1e10, A1=1e10, NPR=0, MXBF=0, IID=2, ITMX=9, ITNW=7, NWTN=3, JAC=0
EPSL=1e-10, EPSU=1e-10, EPSS=1e-9, DS=$3, DSMIN=1e-8, DSMAX=0.1, IADS=1
END
}
TIMEFORMAT=%U
label=0
switch=1
step=-0.01
intervals=50
for period in 1 2 4 8 16; do
    constants $label $switch $step $intervals > fort.2
    : > times
    for run in 1 2 3 4 5 6 7; do
        { time OMP_NUM_THREADS=1 ./cascade > out 2> /dev/null || { cat out; exit 1; } } 2>> times
    done
    count=$(grep -c '^ *[1-9-][0-9]* *-*[1-9]' fort.7)
    time=$(sort -g times | head -1)
    # Type 7 is a doubling; the label is what the next branch starts at.
    found=$(awk '$1 != 0 && $3 == 7 {print $4, $5; exit}' fort.7)
    echo "$period $count $time ${found#* }"
    if [ -z "$found" ]; then break; fi
    label=${found% *}
    switch=-1
    step=0.001
    intervals=$((intervals * 2))
    if [ $intervals -gt 400 ]; then intervals=400; fi
    cp fort.8 fort.3
done
