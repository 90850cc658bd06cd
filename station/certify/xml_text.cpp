#include "station/certify/xml_text.h"

#include "core/file/text.h"

namespace etalon {
namespace {

std::string escaped(std::string text) {
    for (char& c : text)
        if (static_cast<unsigned char>(c) < ' ' || c == 127)
            c = ' ';
    return escape_html(text);
}

}  // namespace

void XmlText::begin(const std::string& name, Attributes attributes) {
    text_ += std::string(2 * open_.size(), ' ') + "<" + name;
    for (const auto& [key, value] : attributes)
        text_ += std::string(" ") + key + "=\"" + escaped(value) + "\"";
}

void XmlText::open(const std::string& name, Attributes attributes) {
    begin(name, attributes);
    text_ += ">\n";
    open_.push_back(name);
}

void XmlText::close() {
    const std::string name = open_.back();
    open_.pop_back();
    text_ += std::string(2 * open_.size(), ' ') + "</" + name + ">\n";
}

void XmlText::leaf(const std::string& name, const std::string& content, Attributes attributes) {
    begin(name, attributes);
    text_ += ">" + escaped(content) + "</" + name + ">\n";
}

}  // namespace etalon
