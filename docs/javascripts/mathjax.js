/* SPDX-License-Identifier: BSD-2-Clause */
/* Equations of pymdownx.arithmatex, and the MathML of fmus/core/build/typeset.py; nothing is
 * loaded but tex-mml-svg.js beside this file. */
window.MathJax = {
  tex: { inlineMath: [["\\(", "\\)"]], displayMath: [["\\[", "\\]"]], processEscapes: true },
  options: { ignoreHtmlClass: ".*|", processHtmlClass: "arithmatex", enableMenu: false },
};
