// AdaptiveController.cpp - inputs from a port, one step per call of the rate group, outputs to a port.
//
// Rejected parameters, inputs and results are events; after a rejected step states and outputs return
// to the step before.
// SPDX-License-Identifier: BSD-2-Clause
#include "AdaptiveController.hpp"
#include "adaptive_controller_parameters.h"

namespace Flight {

namespace {
const F64 PERIOD = 0.1;  // s, of the rate group

template <typename From, U32 N> void copy(const From &from, F64 (&to)[N]) {
    for (U32 i = 0; i < N; i++) to[i] = from[i];
}

Vector vector(const F64 (&a)[3]) { return Vector(a[0], a[1], a[2]); }
}  // namespace

bool AdaptiveController::start() {
    char text[100];
    Fw::ParamValid valid;
    adaptive_controller_defaults(&p, &u);
    p = adaptive_controller_parameters_default;
    p.m_hat_0 = paramGet_MASS(valid);
    if (adaptive_controller_check(&p, text, sizeof text) > 0) {
        log_WARNING_HI_ParametersRejected(Fw::LogStringArg(text));
        return false;
    }
    adaptive_controller_init(&p, &u, &x, &y, 0);
    return true;
}

void AdaptiveController::bodiesIn_handler(NATIVE_INT_TYPE, const Body &target, const Body &servicer,
                                          const Vector &wheelSpeed) {
    copy(target.getr(), u.r_TN_N), copy(target.getv(), u.v_TN_N), copy(target.getq(), u.q_TN);
    copy(target.getomega(), u.omega_TN_T);
    copy(servicer.getr(), u.r_SN_N), copy(servicer.getv(), u.v_SN_N), copy(servicer.getq(), u.q_SN);
    copy(servicer.getomega(), u.omega_SN_S);
    copy(wheelSpeed, u.wheel_speed);
}

void AdaptiveController::schedIn_handler(NATIVE_INT_TYPE, U32) {
    const adaptive_controller_State last = x;
    const adaptive_controller_Output before = y;
    if (!adaptive_controller_good(&u, nullptr, nullptr)) {
        log_WARNING_HI_InputsRejected(steps++);
        return;
    }
    adaptive_controller_step(&p, &u, &x, &y, adaptive_controller_time(0, steps, PERIOD), PERIOD);
    if (!adaptive_controller_good(nullptr, &x, &y)) {
        x = last;
        y = before;
        log_WARNING_HI_ResultRejected(steps);
    }
    steps++;
    wrenchOut_out(0, vector(y.F_cmd_S), vector(y.M_cmd_S), vector(y.wheel_accel_cmd));
}

}  // namespace Flight
