/* SPDX-License-Identifier: BSD-2-Clause */
/* Equations of pymdownx.arithmatex; nothing is loaded but tex-svg.js beside this file. */
window.MathJax = {
  tex: { inlineMath: [["\\(", "\\)"]], displayMath: [["\\[", "\\]"]], processEscapes: true },
  options: { ignoreHtmlClass: ".*|", processHtmlClass: "arithmatex", enableMenu: false },
};
