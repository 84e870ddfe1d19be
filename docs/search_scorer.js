// Order of search results: the glossary first, then pages and the public API, the internals last.
var Scorer = {
  score: ([page, title, anchor, description, score]) =>
    score + (page === "glossary" ? 30 : page.startsWith("generated/internals/") ? -100 : 0),
  // the other values are Sphinx's own (searchtools.js)
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
