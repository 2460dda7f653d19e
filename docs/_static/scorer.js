// Scores of the manual's search: Sphinx's own, but a camera's name stands in cells of the catalogue, which count as
// any text. Whoever types one means its row.
var Scorer = {
  score: ([page, , , , score]) => score + (page === "reference/catalogue" ? 6 : 0),
  objNameMatch: 11, objPartialMatch: 6, objPrio: {0: 15, 1: 5, 2: -5}, objPrioDefault: 0,
  title: 15, partialTitle: 7, term: 5, partialTerm: 2,
};
