for (const table of document.querySelectorAll('table.sortable')) {
  const heads = table.tHead.querySelectorAll('th');
  heads.forEach((head, column) => head.addEventListener('click', () => {
    const order = head.dataset.order === 'down' ? 'up' : 'down';
    heads.forEach(other => delete other.dataset.order);
    head.dataset.order = order;
    const value = row => row.cells[column].dataset.value ?? row.cells[column].textContent;
    const compared = (a, b) => {
      const x = value(a), y = value(b), gap = Number(x) - Number(y);
      return x === '' || y === '' || Number.isNaN(gap) ? x.localeCompare(y) : gap;
    };
    const rows = [...table.tBodies[0].rows].sort(compared);
    table.tBodies[0].append(...(order === 'up' ? rows : rows.reverse()));
  }));
}
for (const field of document.querySelectorAll('input.filter')) {
  field.addEventListener('input', () => {
    const wanted = field.value.toLowerCase();
    for (const row of document.getElementById(field.dataset.table).tBodies[0].rows)
      row.hidden = !row.textContent.toLowerCase().includes(wanted);
  });
}
