pub struct Paper;
pub fn print() {}
pub fn blinking_page() {}
