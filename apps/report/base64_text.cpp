#include "apps/report/base64_text.hpp"

#include <algorithm>
#include <cstddef>

#include <openssl/evp.h>

namespace orbid::apps {

std::string base64_text(std::span<const unsigned char> bytes) {
    // OpenSSL counts in int; whole groups of three bytes per piece keep padding at the end.
    constexpr std::size_t piece = 3 << 20;
    std::string out;
    out.reserve((bytes.size() + 2) / 3 * 4);
    for (std::size_t at = 0; at < bytes.size(); at += piece) {
        const std::size_t size = std::min(piece, bytes.size() - at);
        std::string text((size + 2) / 3 * 4 + 1, '\0');  // OpenSSL ends it with a zero
        const int written =
            EVP_EncodeBlock(reinterpret_cast<unsigned char*>(text.data()), bytes.data() + at, static_cast<int>(size));
        out.append(text, 0, static_cast<std::size_t>(written));
    }
    return out;
}

}  // namespace orbid::apps
