// certificate.yaml (`etalon: certificate/1`): what a certificate states and no record knows.
//
//     etalon: certificate/1
//     number: "2026-0042"                # or --number
//     laboratory: {name: "Optics Laboratory", street: "Main Road 1", postcode: "38116",
//                  city: "Braunschweig", country: DE}        # where the run was made
//     customer: {name: "A & B Robotics", street: "Wall 7", postcode: "1010", city: "Vienna",
//                country: AT}
//     signer: {name: "E. Example", role: "Head of the laboratory"}
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace etalon {

struct PostalContact {
    std::string name, street, postcode, city;
    std::string country;  // two letters of ISO 3166-1
};

struct CertificateForm {
    std::string number;
    PostalContact laboratory, customer;
    std::string signer_name, signer_role;
};

// Any key may be missing and is then empty. Throws ConfigError with file, line and key for unknown
// keys, text that is empty or has line breaks, and countries that are not two capital letters.
CertificateForm read_certificate_form(const std::filesystem::path& path);

// The keys that are missing, as the file would name them.
std::vector<std::string> missing_keys(const CertificateForm& form);

// "Main Road 1, 38116 Braunschweig, DE".
std::string address_of(const PostalContact& contact);

}  // namespace etalon
