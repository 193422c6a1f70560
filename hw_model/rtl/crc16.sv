// The next value of a CRC-16 after one more byte, without a clock. The polynomial is 0x1021, highest bit first, and the value
// before the first byte is 0xFFFF. After a message and its own CRC, highest byte first, the value is 0.
module crc16 (
    input  logic [15:0] crc,
    input  logic [7:0]  data,
    output logic [15:0] next
);
    // Eight steps of the bitwise CRC at once: what leaves at the top comes back as the terms x^12, x^5 and 1 of the polynomial.
    // Its upper four bits reach the top once more within the byte, so they count twice (`mixed`).
    wire [7:0] top = crc[15:8] ^ data;
    wire [7:0] mixed = top ^ {4'b0, top[7:4]};
    assign next = {crc[7:0], 8'b0} ^ {mixed[3:0], 12'b0} ^ {3'b0, mixed, 5'b0} ^ {8'b0, mixed};
endmodule
