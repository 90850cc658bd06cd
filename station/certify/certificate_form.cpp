#include "station/certify/certificate_form.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/config/strict_reader.h"
#include "core/file/text.h"

namespace etalon {
namespace {

// One line of text; empty where the key is missing.
std::string line_of(const Value& section, const char* key) {
    const auto value = section.find(key);
    if (!value)
        return "";
    const std::string text(trimmed(value->text()));
    const auto is_control = [](char c) { return static_cast<unsigned char>(c) < ' ' || c == 127; };
    if (text.empty() || std::ranges::any_of(text, is_control))
        value->fail("must be a line of text");
    return text;
}

std::string country_of(const Value& section) {
    const std::string country = line_of(section, "country");
    const auto is_capital = [](char c) { return c >= 'A' && c <= 'Z'; };
    if (!country.empty() && (country.size() != 2 || !std::ranges::all_of(country, is_capital)))
        section.at("country").fail("must be two capital letters of ISO 3166-1, as DE");
    return country;
}

PostalContact contact_of(const Value& root, const char* key) {
    const auto section = root.find(key);
    if (!section)
        return {};
    return {line_of(*section, "name"), line_of(*section, "street"), line_of(*section, "postcode"),
            line_of(*section, "city"), country_of(*section)};
}

void add_missing(std::vector<std::string>& missing, const char* key, const PostalContact& contact) {
    const std::pair<const char*, const std::string&> parts[] = {{"name", contact.name},
                                                                {"street", contact.street},
                                                                {"postcode", contact.postcode},
                                                                {"city", contact.city},
                                                                {"country", contact.country}};
    for (const auto& [part, text] : parts)
        if (text.empty())
            missing.push_back(fmt::format("{}.{}", key, part));
}

}  // namespace

CertificateForm read_certificate_form(const std::filesystem::path& path) {
    const StrictFile file(path, "certificate/1");
    const Value root = file.root();
    CertificateForm form;
    form.number = line_of(root, "number");
    form.laboratory = contact_of(root, "laboratory");
    form.customer = contact_of(root, "customer");
    if (const auto signer = root.find("signer")) {
        form.signer_name = line_of(*signer, "name");
        form.signer_role = line_of(*signer, "role");
    }
    file.finish();
    return form;
}

std::vector<std::string> missing_keys(const CertificateForm& form) {
    std::vector<std::string> missing;
    if (form.number.empty())
        missing.emplace_back("number");
    add_missing(missing, "laboratory", form.laboratory);
    add_missing(missing, "customer", form.customer);
    if (form.signer_name.empty())
        missing.emplace_back("signer.name");
    if (form.signer_role.empty())
        missing.emplace_back("signer.role");
    return missing;
}

std::string address_of(const PostalContact& contact) {
    return fmt::format("{}, {} {}, {}", contact.street, contact.postcode, contact.city,
                       contact.country);
}

}  // namespace etalon
