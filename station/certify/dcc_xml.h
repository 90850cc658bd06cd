// XML 1.0, written element by element with two spaces a level. What XML cannot hold (control
// characters) becomes a space.
#pragma once

#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

namespace etalon {

class XmlText {
public:
    using Attributes = std::initializer_list<std::pair<const char*, std::string>>;

    XmlText() : text_("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n") {}

    void open(const std::string& name, Attributes attributes = {});
    void close();  // the one that was opened last
    void leaf(const std::string& name, const std::string& content, Attributes attributes = {});

    const std::string& text() const { return text_; }

private:
    void begin(const std::string& name, Attributes attributes);

    std::string text_;
    std::vector<std::string> open_;
};

}  // namespace etalon
