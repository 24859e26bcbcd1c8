"""The equations of motion: integrated, differentiated and in weak form."""
