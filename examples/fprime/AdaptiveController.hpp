// AdaptiveController.hpp - adaptive_controller as a component of F Prime.
// SPDX-License-Identifier: BSD-2-Clause
#ifndef FLIGHT_ADAPTIVE_CONTROLLER_HPP
#define FLIGHT_ADAPTIVE_CONTROLLER_HPP

#include "Flight/AdaptiveControllerComponentAc.hpp"
#include "adaptive_controller.h"

namespace Flight {

class AdaptiveController final : public AdaptiveControllerComponentBase {
  public:
    explicit AdaptiveController(const char *name) : AdaptiveControllerComponentBase(name) {}
    bool start();  // after loadParameters(); false: the parameters are rejected

  private:
    void bodiesIn_handler(NATIVE_INT_TYPE port, const Body &target, const Body &servicer,
                          const Vector &wheelSpeed) override;
    void schedIn_handler(NATIVE_INT_TYPE port, U32 context) override;

    adaptive_controller_Parameters p = {};
    adaptive_controller_Input u = {};
    adaptive_controller_State x = {};
    adaptive_controller_Output y = {};
    F64 steps = 0;
};

}  // namespace Flight

#endif
