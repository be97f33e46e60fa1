@ Flight software of the project as components
module Flight {

  array Vector = [3] F64
  array Quaternion = [4] F64

  @ Body state in N axes and body axes
  struct Body { r: Vector, v: Vector, q: Quaternion, omega: Vector }

  port Bodies($target: Body, servicer: Body, wheelSpeed: Vector)
  port Wrench(force: Vector, torque: Vector, wheelAcceleration: Vector)

  @ Position and attitude control by adaptive_controller, one step per call of the rate group
  passive component AdaptiveController {
    sync input port schedIn: Svc.Sched
    sync input port bodiesIn: Bodies
    output port wrenchOut: Wrench

    event port eventOut
    text event port textEventOut
    time get port timeGetOut
    param get port paramGetOut
    param set port paramSetOut
    command reg port cmdRegOut
    command recv port cmdIn
    command resp port cmdResponseOut

    param MASS: F64 default 95.0

    event ParametersRejected(reason: string size 100) severity warning high format "{}"
    event InputsRejected(k: F64) severity warning high format "step {}: inputs rejected"
    event ResultRejected(k: F64) severity warning high format "step {}: result rejected"
  }
}
