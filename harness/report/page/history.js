/* Interpolation of the arrays of a replay between its instants. */
"use strict";
function historyOf(times, T) {
  const first = times[0], last = times[times.length - 1], other = new T.Quaternion();

  /* low, high: indices of the instants before and after the time t [s]; part: share of the interval
   * between the two instants that has passed at t */
  function place(t) {
    let low = 0, high = times.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= t) low = middle; else high = middle;
    }
    const span = times[high] - times[low];
    return { low, high, part: span > 0 ? Math.min(1, Math.max(0, (t - times[low]) / span)) : 0 };
  }
  const between = (values, at, n, k) =>
    values[n * at.low + k] + at.part * (values[n * at.high + k] - values[n * at.low + k]);
  const quaternionAt = (values, k, out) =>
    out.set(values[4 * k + 1], values[4 * k + 2], values[4 * k + 3], values[4 * k]).normalize();

  return {
    times, first, last, span: last - first, place, quaternionAt,
    scalar: (values, at) => between(values, at, 1, 0),
    column: (values, at, k) => between(values, at, values.shape[1] || 1, k),
    vector: (values, at, out) => out.set(...[0, 1, 2].map((k) => between(values, at, 3, k))),
    quaternion: (values, at, out) =>
      quaternionAt(values, at.low, out).slerp(quaternionAt(values, at.high, other), at.part),
    /* value of an array whose values are constant from one instant to the next, such as a state */
    state: (values, at) => values[at.part < 1 ? at.low : at.high],
    /* time of the instant that is `count` instants after t (negative: before t) */
    step(t, count) {
      const { low, high, part } = place(t);
      const from = count > 0 ? (part >= 1 ? high : low) : (part > 0 ? high : low);
      return times[Math.min(times.length - 1, Math.max(0, from + count))];
    },
  };
}
