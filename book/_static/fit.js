// On a narrow page a formula or a table that is too wide is set smaller, as far as it can still be
// read; what is wider even then scrolls by itself.
(() => {
  "use strict";
  const LEAST = {
    'article mjx-container[display="true"]': 0.7,
    "article .pst-scrollable-table-container": 0.75,
  };
  const narrow = window.matchMedia("(max-width: 700px)");

  function fit() {
    for (const [kind, least] of Object.entries(LEAST)) {
      const all = [...document.querySelectorAll(kind)];
      for (const each of all) {
        each.style.removeProperty("--fit");
        each.classList.remove("lissome-wide");
      }
      if (!narrow.matches) continue;
      // Cells have padding, and words that wrap: their width is not in proportion to their type.
      const share = new Map(all.map((each) => [each, 1]));
      for (let pass = 0; pass < 3; pass++) {
        const wide = all.filter((each) => each.scrollWidth > each.clientWidth && share.get(each) > least);
        for (const each of wide) {
          const next = (0.99 * share.get(each) * each.clientWidth) / each.scrollWidth;
          share.set(each, Math.max(least, next));
        }
        for (const each of wide) each.style.setProperty("--fit", share.get(each));
      }
      const left = all.filter((each) => each.scrollWidth > each.clientWidth + 1);
      for (const each of left) each.classList.add("lissome-wide");
    }
  }

  let width = 0;
  function settle() {
    if (window.innerWidth === width) return; // the bars of a phone come and go with its height
    width = window.innerWidth;
    fit();
  }

  window.addEventListener("load", () => {
    const typeset = window.MathJax?.startup?.promise ?? Promise.resolve();
    typeset.then(() => document.fonts.ready).then(settle);
    window.addEventListener("resize", () => {
      if (width) settle();
    });
  });
})();
