/* Conversion of names such as rho_ref in texts into symbols with an index, as
 * harness/figures/finish.py does in printed figures. Names of variables (guidance.rho_ref_N) are
 * unchanged. */
"use strict";
const Symbols = (() => {
  const LETTERS = { alpha: "α", beta: "β", gamma: "γ", delta: "δ", epsilon: "ε", zeta: "ζ", eta: "η", theta: "θ",
    kappa: "κ", lambda: "λ", mu: "μ", nu: "ν", xi: "ξ", rho: "ρ", sigma: "σ", tau: "τ", phi: "φ", chi: "χ",
    psi: "ψ", omega: "ω", Delta: "Δ", Gamma: "Γ", Omega: "Ω" };
  const greek = Object.keys(LETTERS).join("|");
  const SYMBOL = new RegExp(`(?<![\\w$\\\\.])(?:(${greek}|[A-Za-z])_(\\w+)|(${greek}))(?![\\w.])`, "g");
  const escaped = (text) => text.replace(/[&<>]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;" })[c]);

  /* the text as HTML, for Plotly and for elements */
  const html = (text) => escaped(text || "").replace(SYMBOL, (_, base, index, alone) =>
    (alone ? LETTERS[alone] : `${LETTERS[base] || base}<sub>${index.replace(/_/g, ",")}</sub>`));
  return { html, escaped };
})();
if (typeof module !== "undefined") module.exports = Symbols;
