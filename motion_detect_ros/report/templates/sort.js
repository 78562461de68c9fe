'use strict';

/* Tables whose headers hold buttons: a click sorts by that column, another one the other way round. */
function sortBy(header) {
  const table = header.closest('table'), body = table.tBodies[0];
  const column = [...header.parentNode.children].indexOf(header);
  const down = header.getAttribute('aria-sort') === 'ascending' ||
    (header.getAttribute('aria-sort') !== 'descending' && header.dataset.first === 'descending');
  for (const other of header.parentNode.children) other.removeAttribute('aria-sort');
  header.setAttribute('aria-sort', down ? 'descending' : 'ascending');
  const value = row => {
    const text = row.cells[column].dataset.value ?? row.cells[column].textContent.trim();
    return text === '' ? null : Number.isNaN(Number(text)) ? text : Number(text);
  };
  const compare = (one, other) => {
    const a = value(one), b = value(other);
    if (a === null || b === null) return (a === null) - (b === null);  // unknown ones stay at the end
    const order = typeof a === 'number' && typeof b === 'number' ? a - b : String(a).localeCompare(String(b));
    return down ? -order : order;
  };
  body.append(...[...body.rows].sort(compare));
}

for (const button of document.querySelectorAll('th button')) {
  button.addEventListener('click', () => sortBy(button.closest('th')));
}
