// SPDX-License-Identifier: Apache-2.0
// `-p name=value` for a parameter of every type: what is read is written and read again the same.
#include "rayloom/core/param.h"
#include "tests/fuzz/target.h"

#include <string>

namespace
{

void read_as(rayloom::ParamType type, const std::string& text)
{
    rayloom::ParamInfo info;
    info.name = "p";
    info.type = type;
    info.choices = {"one", "two", "three"};
    if (type == rayloom::ParamType::real || type == rayloom::ParamType::integer) {
        info.min = -1e6;
        info.max = 1e6;
    }
    const rayloom::ParamValue value = rayloom::parse_param(info, text);
    // Numbers come back; texts may hold what a command line would split.
    if (rayloom::is_textual(type) && type != rayloom::ParamType::choice) return;
    if (!(rayloom::parse_param(info, rayloom::format_param(value)) == value)) std::abort();
}

} // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size)
{
    if (size == 0) return 0;
    const auto type = static_cast<rayloom::ParamType>(data[0] % rayloom::param_type_names().size());
    const std::string text(reinterpret_cast<const char*>(data) + 1, size - 1);
    rayloom::fuzz::answer([&] { read_as(type, text); });
    return 0;
}
