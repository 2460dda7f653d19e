// Sphinx's own scores, and pages first whose title has all that was typed: its search leaves out words as short as "3".
var Scorer = {
  score: ([, title, , , score]) => {
    const words = (new URLSearchParams(location.search).get("q") || "").toLowerCase().match(/[\p{L}\p{N}]+/gu) || [];
    const named = title.toLowerCase().match(/[\p{L}\p{N}]+/gu) || [];
    const starts = words.every((word) => named.some((one) => one.startsWith(word)));
    return score + (words.length && starts ? 100 : 0);
  },
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
